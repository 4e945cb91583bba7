"""Robot descriptions without kinematics: DH tables, URDF, xacro, MJCF, SRDF, and the catalogue of robots."""

from pinproof.description.catalogue import (
    OVERLAP_REASON,
    CatalogueEntry,
    catalogue_names,
    find_robot,
    read_description,
    robots_folder,
)
from pinproof.description.dh import DhRow, DhTable
from pinproof.description.srdf import Srdf, read_srdf
from pinproof.description.urdf import LinkGeometry, Urdf, UrdfJoint, read_urdf, read_urdf_text

__all__ = [
    "OVERLAP_REASON",
    "CatalogueEntry",
    "DhRow",
    "DhTable",
    "LinkGeometry",
    "Srdf",
    "Urdf",
    "UrdfJoint",
    "catalogue_names",
    "find_robot",
    "read_description",
    "read_srdf",
    "read_urdf",
    "read_urdf_text",
    "robots_folder",
]
