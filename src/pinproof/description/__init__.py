"""Robot descriptions without kinematics: DH tables, URDF, xacro, MJCF, SRDF, and the catalogue of robots."""

from pinproof.common import faces
from pinproof.description.calibration import (
    JOINTS_OF_UR as JOINTS_OF_UR,
    Calibration as Calibration,
    calibration_format as calibration_format,
    read_calibration as read_calibration,
    with_origins as with_origins,
)
from pinproof.description.catalogue import (
    OVERLAP_REASON as OVERLAP_REASON,
    CatalogueEntry as CatalogueEntry,
    catalogue_names as catalogue_names,
    find_robot as find_robot,
    notes as notes,
    read_description as read_description,
    robots_folder as robots_folder,
)
from pinproof.description.cell import (
    CELL as CELL,
    PLACEMENT_JOINTS as PLACEMENT_JOINTS,
    WORLD as WORLD,
    Axis as Axis,
    cell_srdf as cell_srdf,
    cell_urdf as cell_urdf,
    rerooted as rerooted,
    urdf_with_axes as urdf_with_axes,
    with_frame as with_frame,
    with_movable_base as with_movable_base,
    with_spin as with_spin,
)
from pinproof.description.dh import (
    CONVENTIONS as CONVENTIONS,
    DEFAULT_EFFORT as DEFAULT_EFFORT,
    MAKES as MAKES,
    SUFFIXES as SUFFIXES,
    DhRow as DhRow,
    DhTable as DhTable,
    Make as Make,
    row_transform as row_transform,
)
from pinproof.description.dh_urdf import (
    GENERATED_BODIES as GENERATED_BODIES,
    GENERATED_MASSES as GENERATED_MASSES,
    TCP as TCP,
    has_generated_bodies as has_generated_bodies,
    urdf_of_table as urdf_of_table,
)
from pinproof.description.mesh_stl_obj_ply import positions as positions, read_elements as read_elements
from pinproof.description.meshes import (
    COLOURED_SUFFIXES as COLOURED_SUFFIXES,
    MESH_SUFFIXES as MESH_SUFFIXES,
    TriangleMesh as TriangleMesh,
    mesh_of_file as mesh_of_file,
    metres_per_unit as metres_per_unit,
    read_mesh as read_mesh,
    resolved as resolved,
    stored_mesh as stored_mesh,
    z_up as z_up,
)
from pinproof.description.ros_files import MeshFile as MeshFile, locate as locate
from pinproof.description.srdf import (
    DisabledPair as DisabledPair,
    Srdf as Srdf,
    read_srdf as read_srdf,
    srdf_text as srdf_text,
)
from pinproof.description.urdf import (
    VISUALS_CAN_BE_CHECKED as VISUALS_CAN_BE_CHECKED,
    JointType as JointType,
    LinkGeometry as LinkGeometry,
    Urdf as Urdf,
    UrdfJoint as UrdfJoint,
    moved_by as moved_by,
    read_urdf as read_urdf,
    read_urdf_text as read_urdf_text,
    urdf_of as urdf_of,
)
from pinproof.description.xml_reader import (
    add_joint as add_joint,
    numbers_text as numbers_text,
    origin_attributes as origin_attributes,
)

__all__ = faces.exported(globals())
