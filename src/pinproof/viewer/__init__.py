"""Viewer: HTML pages of an arm, a scene and a motion, the same page live, and PNG pictures."""

from pinproof.viewer.live import LiveView, show
from pinproof.viewer.overlays import ColouredPoints
from pinproof.viewer.page import write_html
from pinproof.viewer.plots import PlotLimits
from pinproof.viewer.png import write_png

__all__ = ["ColouredPoints", "LiveView", "PlotLimits", "show", "write_html", "write_png"]
