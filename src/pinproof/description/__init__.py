"""Robot descriptions without kinematics: DH tables, URDF, xacro, MJCF, SRDF, and the catalogue of robots."""

from pinproof.description.catalogue import (
    OVERLAP_REASON,
    CatalogueEntry,
    catalogue_names,
    find_robot,
    notes,
    read_description,
    robots_folder,
)
from pinproof.description.cell import (
    CELL,
    PLACEMENT_JOINTS,
    WORLD,
    Axis,
    cell_srdf,
    cell_urdf,
    urdf_with_axes,
    with_movable_base,
)
from pinproof.description.dh import CONVENTIONS, DEFAULT_EFFORT, SUFFIXES, DhRow, DhTable
from pinproof.description.dh_urdf import GENERATED_BODIES, GENERATED_MASSES, TCP, has_generated_bodies, urdf_of_table
from pinproof.description.mesh_stl_obj_ply import positions, read_elements
from pinproof.description.meshes import COLOURED_SUFFIXES, TriangleMesh, metres_per_unit, read_mesh, resolved, z_up
from pinproof.description.ros_files import MeshFile, locate
from pinproof.description.srdf import DisabledPair, Srdf, read_srdf, srdf_text
from pinproof.description.urdf import JointType, LinkGeometry, Urdf, UrdfJoint, moved_by, read_urdf, read_urdf_text

__all__ = [
    "CELL",
    "COLOURED_SUFFIXES",
    "CONVENTIONS",
    "DEFAULT_EFFORT",
    "GENERATED_BODIES",
    "GENERATED_MASSES",
    "OVERLAP_REASON",
    "PLACEMENT_JOINTS",
    "SUFFIXES",
    "TCP",
    "WORLD",
    "Axis",
    "CatalogueEntry",
    "DhRow",
    "DhTable",
    "DisabledPair",
    "JointType",
    "LinkGeometry",
    "MeshFile",
    "Srdf",
    "TriangleMesh",
    "Urdf",
    "UrdfJoint",
    "catalogue_names",
    "cell_srdf",
    "cell_urdf",
    "find_robot",
    "has_generated_bodies",
    "locate",
    "metres_per_unit",
    "moved_by",
    "notes",
    "positions",
    "read_description",
    "read_elements",
    "read_mesh",
    "read_srdf",
    "read_urdf",
    "read_urdf_text",
    "resolved",
    "robots_folder",
    "srdf_text",
    "urdf_of_table",
    "urdf_with_axes",
    "with_movable_base",
    "z_up",
]
