"""Viewer: HTML pages of an arm, a scene and a motion, the same page live, and PNG pictures."""

from pinproof.common import faces
from pinproof.viewer.camera import (
    View as View, choose_view as choose_view, extremes as extremes, placed_points as placed_points,
    tool_points as tool_points,
)  # fmt: skip
from pinproof.viewer.live import LiveView as LiveView, show as show
from pinproof.viewer.overlays import (
    LONGEST as LONGEST, ColouredPoints as ColouredPoints, PoseMarkers as PoseMarkers, arrow as arrow,
)  # fmt: skip
from pinproof.viewer.page import PlotLimits as PlotLimits, write_html as write_html
from pinproof.viewer.panels import Bar as Bar, legend as legend
from pinproof.viewer.picture import stage_commands as stage_commands
from pinproof.viewer.png import write_png as write_png
from pinproof.viewer.stage import (
    Drawing as Drawing, DrawnLink as DrawnLink, DrawnObstacle as DrawnObstacle, Film as Film, FilmPhase as FilmPhase,
    box_corners as box_corners, film as film, set_stage as set_stage, simplified as simplified, still as still,
    tracks as tracks,
)  # fmt: skip
from pinproof.viewer.surfaces import (
    Surface as Surface, merge_by_colour as merge_by_colour, obstacle_surfaces as obstacle_surfaces,
)  # fmt: skip
from pinproof.viewer.web_cell import WebCell as WebCell
from pinproof.viewer.wire import Commands as Commands, node_path as node_path, transform_command as transform_command

__all__ = faces.exported(globals())
