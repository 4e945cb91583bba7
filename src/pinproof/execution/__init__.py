"""Certified motions in use: a library for scenes that change, a monitor of their execution, and messages of ROS 2."""

from pinproof.execution.monitor import Monitor, MonitorResult, MonitorStatus
from pinproof.execution.motion_library import MotionLibrary, RepairResult, StoredMotion

__all__ = ["Monitor", "MonitorResult", "MonitorStatus", "MotionLibrary", "RepairResult", "StoredMotion"]
