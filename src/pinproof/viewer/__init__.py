"""Viewer: HTML pages of an arm, a scene and a motion, the same page live, and PNG pictures."""

from pinproof.viewer.camera import View, choose_view, extremes, placed_points, tool_points
from pinproof.viewer.live import LiveView, show
from pinproof.viewer.overlays import LONGEST, ColouredPoints, PoseMarkers, arrow
from pinproof.viewer.page import PlotLimits, write_html
from pinproof.viewer.panels import Bar
from pinproof.viewer.picture import stage_commands
from pinproof.viewer.png import write_png
from pinproof.viewer.stage import (
    Drawing,
    DrawnLink,
    Film,
    FilmPhase,
    box_corners,
    film,
    set_stage,
    simplified,
    still,
    tracks,
)
from pinproof.viewer.surfaces import Surface, merge_by_colour, obstacle_surfaces
from pinproof.viewer.wire import Commands, node_path, transform_command

__all__ = [
    "LONGEST",
    "Bar",
    "ColouredPoints",
    "Commands",
    "Drawing",
    "DrawnLink",
    "Film",
    "FilmPhase",
    "LiveView",
    "PlotLimits",
    "PoseMarkers",
    "Surface",
    "View",
    "arrow",
    "box_corners",
    "choose_view",
    "extremes",
    "film",
    "merge_by_colour",
    "node_path",
    "obstacle_surfaces",
    "placed_points",
    "set_stage",
    "show",
    "simplified",
    "stage_commands",
    "still",
    "tool_points",
    "tracks",
    "transform_command",
    "write_html",
    "write_png",
]
