"""Conversion of DH tables to URDF and back, verified by comparing the forward kinematics of both."""

from pinproof.conversion.dh_tables import dh_to_urdf, urdf_to_dh, write_urdf

__all__ = ["dh_to_urdf", "urdf_to_dh", "write_urdf"]
