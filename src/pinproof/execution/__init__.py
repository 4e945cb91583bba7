"""Certified motions in use: a library of motions for scenes that change, and a monitor for their execution."""

from pinproof.execution.monitor import Monitor, MonitorResult, MonitorStatus
from pinproof.execution.motion_library import MotionLibrary, RepairResult, StoredMotion

__all__ = ["Monitor", "MonitorResult", "MonitorStatus", "MotionLibrary", "RepairResult", "StoredMotion"]
