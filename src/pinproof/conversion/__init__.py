"""Turning one description of an arm into another, each proven by forward kinematics before it is handed over."""

from pinproof.conversion.dh_urdf import dh_to_urdf, write_urdf
from pinproof.conversion.urdf_dh import urdf_to_dh

__all__ = ["dh_to_urdf", "urdf_to_dh", "write_urdf"]
