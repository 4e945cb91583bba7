"""The keys of proof files.

The verifier shares no code with the other packages and has its own list of fields; a test compares both.
"""

from __future__ import annotations

from pinproof.common.structs import (
    ANY_TEXT,
    COUNT,
    NOT_NEGATIVE,
    NULL,
    OPTIONAL_NUMBER,
    PLAIN_NUMBER,
    TEXT,
    Key,
    Table,
    any_of,
    choice,
    integer,
    list_of,
    mapping_to,
    required,
    simple,
    vector,
)
from pinproof.verifier import FORMAT, VERSION

HASH = simple({"type": "string", "pattern": "^[0-9a-f]{64}$"})
JOINT = integer(-1)
VECTOR = vector(3, PLAIN_NUMBER)
PLACEMENT = list_of(vector(4, PLAIN_NUMBER), 3, 3)

CLAIM = Table(
    "claim",
    "What the proof states.",
    required("status", choice("FREE"), "the status of the certificate"),
    required(
        "clearance", OPTIONAL_NUMBER, "any two checked bodies are at least this far apart; null without pairs", "m"
    ),
)

SETTINGS = Table(
    "settings",
    "The distances and tolerances that the proof includes.",
    required("margin", NOT_NEGATIVE, "required distance between any two owners", "m"),
    required(
        "margins",
        list_of(simple({"type": "array", "prefixItems": [TEXT, TEXT, NOT_NEGATIVE], "minItems": 3, "maxItems": 3})),
        "distances of single pairs: owner, owner, metres",
        "m",
    ),
    required("joint_tolerance", list_of(NOT_NEGATIVE), "deviation of each joint of the curve", "rad or m"),
    required("obstacle_tolerance", NOT_NEGATIVE, "deviation of obstacles", "m"),
)

HASHES = Table(
    "hashes",
    "SHA-256 hashes; only that of the curve is checked.",
    Key("model", HASH, "of the kinematics of the URDF as text"),
    Key("scene", HASH, "of the obstacles"),
    required("curve", HASH, "of the curve, see below; a `Certificate` has the same under `curve`"),
    Key("setup", HASH, "of the arm, the scene and the attached bodies"),
    more=True,
)

ARM = Table(
    "arm",
    "An arm.",
    Key("base", ANY_TEXT, "base link of the arm"),
    Key("tcp", ANY_TEXT, "tcp frame of the arm"),
)

ROBOT = Table(
    "robot",
    "The robot, for readers; it is not checked, because the placements contain it.",
    Key("name", ANY_TEXT, "name of the robot"),
    Key("arms", mapping_to(ARM), "the arms by name; an arm alone has the name of its tcp"),
    Key("held", mapping_to(PLAIN_NUMBER), "values of the joints outside the arm", "rad or m"),
    more=True,
)

CURVE = Table(
    "curve",
    "The motion as a piecewise polynomial in Bernstein form. A single configuration is one piece of no width.",
    required("joint_names", list_of(TEXT, 1), "the n joints"),
    required("knots", list_of(PLAIN_NUMBER, 2), "k + 1 strictly increasing parameters, for a timed motion in seconds"),
    required(
        "control",
        list_of(list_of(list_of(PLAIN_NUMBER, 1), 1), 1),
        "(k, degree + 1, n) control points of each piece",
        "rad or m",
    ),
)

PROOF_LIMITS = Table(
    "proof_limits",
    "The limits that each joint of the curve keeps, except for 1e-6 (rad or m; of rates relative); null for no limit.",
    required("lower", list_of(OPTIONAL_NUMBER), "lower limit of the position", "rad or m"),
    required("upper", list_of(OPTIONAL_NUMBER), "upper limit of the position", "rad or m"),
    required("velocity", list_of(OPTIONAL_NUMBER), "limit of the speed", "rad/s or m/s"),
    required("acceleration", list_of(OPTIONAL_NUMBER), "limit of the acceleration", "rad/s² or m/s²"),
)

PROOF_JOINT = Table(
    "joint",
    "A joint that moves with the arm. Its value is multiplier * q[leader] + offset, so a mimic follower has the leader "
    "of the joint that it follows.",
    required("name", TEXT, "name of the joint"),
    required("type", choice("revolute", "prismatic"), "type of the joint"),
    required("axis", VECTOR, "unit vector in the frame of the joint"),
    required("placement", PLACEMENT, "parent_from_joint at the value 0", "m"),
    required("parent", JOINT, "index of the parent joint, which is earlier in the list; -1 for the root"),
    required("leader", COUNT, "index of the joint of the curve that determines the value"),
    required("multiplier", PLAIN_NUMBER, "factor of the value of the leader"),
    required("offset", PLAIN_NUMBER, "value at q[leader] = 0", "rad or m"),
)

SHAPE = Table(
    "convex_shape",
    "The convex hull of points, each with a flat disc about the body's z, grown by a ball and by an ellipsoid: boxes "
    "and hulls (points), spheres (one point), capsules (two points), cylinders (two discs), cones (a disc and a "
    "point), ellipsoids.",
    required("points", list_of(VECTOR, 1), "(V, 3) the points", "m"),
    required("disc_radii", list_of(NOT_NEGATIVE, 1), "(V,) radius of the disc of each point", "m"),
    required("radius", NOT_NEGATIVE, "radius of the ball", "m"),
    required("semi_axes", vector(3, NOT_NEGATIVE), "semi-axes of the ellipsoid", "m"),
)

PROOF_BODY = Table(
    "body",
    "A convex body. All bodies of a geometry on one level represent it: one hull, or several closer ones. A pair may "
    "be proven on any level.",
    required("name", TEXT, "unique in the file"),
    required("owner", TEXT, "the link, attached object or obstacle that it is part of"),
    required("kind", choice("link", "attached", "obstacle"), "kind of the owner"),
    required("geometry", TEXT, "the geometry that it represents, with the other bodies of this name"),
    required("level", COUNT, "level of detail, 0 to 2"),
    Key("source", TEXT, "kind and file of the geometry; not checked"),
    Key("mesh_sha256", HASH, "hash of the mesh file; not checked"),
    required("joint", JOINT, "index of the joint that moves it; -1 for the root"),
    required("placement", PLACEMENT, "joint_from_body", "m"),
    required(
        "shape",
        any_of(SHAPE, choice("half_space"), NULL),
        "a convex shape; `half_space`: everything below the body's z = 0; null: a body that is in no pair",
    ),
    required("sha256", HASH, "hash of the numbers of the body, see below"),
)

PAIR = Table(
    "pair",
    "The evidence for one pair of bodies: on each interval a direction along which they are apart.",
    required("bodies", list_of(COUNT, 2, 2), "indices of the two bodies, an obstacle second"),
    required("intervals", list_of(COUNT), "indices of intervals, which together cover the curve"),
    required(
        "directions",
        list_of(VECTOR),
        "a unit vector for each interval, in the frame of the root link, from the first body to the second",
    ),
)

CORNER = list_of(OPTIONAL_NUMBER, 3, 3)

CONSTRAINT = Table(
    "constraint",
    "A constraint of the tcp, which holds on the whole curve. `direction`: the angle between `axis` and `direction`. "
    "`region`: the distance of `point` from a box. `target`: the angle between `axis` and the direction from `origin` "
    "to `point`. Vectors of the tcp are in the frame of the joint that carries it, all others in the root frame.",
    required("name", TEXT, "description for readers"),
    required("kind", choice("direction", "region", "target"), "kind of the constraint"),
    required("joint", JOINT, "index of the joint that carries the tcp; -1 for the root"),
    Key("axis", VECTOR, "`direction`, `target`: unit vector of the tcp"),
    Key("direction", VECTOR, "`direction`: unit vector in the root frame"),
    Key("origin", VECTOR, "`target`: the origin of the tcp", "m"),
    Key("point", VECTOR, "`region`: point of the tcp; `target`: point in the root frame", "m"),
    Key("placement", PLACEMENT, "`region`: root_from_box", "m"),
    Key("low", CORNER, "`region`: lower corner of the box; null for no end", "m"),
    Key("high", CORNER, "`region`: upper corner of the box; null for no end", "m"),
    required("tolerance", NOT_NEGATIVE, "largest allowed error", "rad or m"),
    required("largest", NOT_NEGATIVE, "claimed largest error, at most `tolerance`", "rad or m"),
    required(
        "intervals",
        list_of(vector(2, PLAIN_NUMBER)),
        "start and end of each interval on which it is proven; together they cover the curve",
    ),
)

PROOF = Table(
    "proof",
    "A proof that a motion is collision-free. A placement is three rows of four numbers: rotation and translation. "
    "Indices begin at 0.",
    required("format", choice(FORMAT), "name of the format"),
    required("version", choice(VERSION), "version of the format"),
    Key("made_by", ANY_TEXT, "name and version of the program; not checked"),
    required("claim", CLAIM, "what the proof states"),
    required("settings", SETTINGS, "distances and tolerances"),
    required("hashes", HASHES, "hashes of the inputs"),
    Key("robot", ROBOT, "the robot, for readers"),
    required("curve", CURVE, "the motion"),
    required("limits", any_of(PROOF_LIMITS, NULL), "the joint limits that the motion keeps; null: not compared"),
    required("joints", list_of(PROOF_JOINT), "the joints that move, each after its parent"),
    required("bodies", list_of(PROOF_BODY), "the bodies"),
    Key("notes", list_of(ANY_TEXT), "assumptions of the certificate"),
    required("excluded", list_of(list_of(TEXT, 3, 3)), "pairs that the proof does not cover: owner, owner, reason"),
    required("intervals", list_of(vector(2, PLAIN_NUMBER)), "start and end, in the parameter of the curve"),
    required("pairs", list_of(PAIR), "the evidence"),
    Key("constraints", list_of(CONSTRAINT), "constraints of the tcp", "", []),
)
