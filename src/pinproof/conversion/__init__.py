"""Conversion of DH tables to URDF and back, verified by comparing the forward kinematics of both."""

from pinproof.conversion.from_dh import dh_to_urdf, write_urdf
from pinproof.conversion.to_dh import urdf_to_dh

__all__ = ["dh_to_urdf", "urdf_to_dh", "write_urdf"]
