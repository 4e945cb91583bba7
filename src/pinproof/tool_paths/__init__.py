"""Tool paths: the best joint motion along a whole path of the tool, certified, or why no motion exists."""

from pinproof.common import faces
from pinproof.tool_paths.campaigns import path_campaign as path_campaign
from pinproof.tool_paths.files import (
    JOB as JOB,
    StrokeSource as StrokeSource,
    ToolJob as ToolJob,
    read_tool_paths as read_tool_paths,
)
from pinproof.tool_paths.following import follow as follow
from pinproof.tool_paths.ordering import (
    FollowedStroke as FollowedStroke,
    StrokesPlan as StrokesPlan,
    follow_all as follow_all,
)
from pinproof.tool_paths.path import ToolPath as ToolPath
from pinproof.tool_paths.geometry import (
    Contour as Contour,
    Raster as Raster,
    contour as contour,
    raster as raster,
)
from pinproof.tool_paths.path_files import PathPoints as PathPoints
from pinproof.tool_paths.pictures import RotationStrip as RotationStrip, rotation_strip as rotation_strip
from pinproof.tool_paths.placement import place_job as place_job
from pinproof.tool_paths.program import (
    ProgramMotion as ProgramMotion,
    ToolPathProgram as ToolPathProgram,
    export_motions as export_motions,
    require_language as require_language,
)
from pinproof.tool_paths.report import (
    FollowReport as FollowReport,
    StrokeReport as StrokeReport,
    follow_job as follow_job,
    profile_job as profile_job,
)
from pinproof.tool_paths.result import (
    BlockedPose as BlockedPose,
    FollowPlan as FollowPlan,
    FollowStatus as FollowStatus,
    Obstruction as Obstruction,
    PathPiece as PathPiece,
)
from pinproof.tool_paths.rungs import COSTS as COSTS, FollowCosts as FollowCosts
from pinproof.tool_paths.strokes import Stroke as Stroke
from pinproof.tool_paths.suggestions import PathSuggestion as PathSuggestion, suggest_changes as suggest_changes

__all__ = faces.exported(globals())
