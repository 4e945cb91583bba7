"""What is seen: a self-contained page of arm, scene, motion and certificate, and the same page live (meshcat)."""

from pinproof.viewer.cloud import ColouredPoints
from pinproof.viewer.live import LiveView, show
from pinproof.viewer.page import write_html

__all__ = ["ColouredPoints", "LiveView", "show", "write_html"]
