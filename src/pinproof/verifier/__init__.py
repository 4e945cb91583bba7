"""Re-checks saved proofs with NumPy alone, by code that is independent of the code that makes them.

Nothing here imports the rest of pinproof, so a robot cell can trust a proof without trusting its maker:
``python -m pinproof.verifier proof.json``, or copy this folder anywhere and run ``python -m verifier proof.json``.
The file format is described in docs/formats/proof.md.
"""

from .interval_bounds import IntervalBounds
from .parts import Refused, body_digest, curve_digest, load
from .proof import FORMAT, VERSION, Parts, Proof, ProofVerdict, verify

__all__ = [
    "FORMAT",
    "VERSION",
    "IntervalBounds",
    "Parts",
    "Proof",
    "ProofVerdict",
    "Refused",
    "body_digest",
    "curve_digest",
    "load",
    "verify",
]
