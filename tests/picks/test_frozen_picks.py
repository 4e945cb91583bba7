"""What picks were judged by cannot be changed afterwards."""

from __future__ import annotations

import pickle

import pytest

import pinproof as pp
from pinproof.picks.input.picks import NamedFrame


def test_poses_of_picks_places_and_frames_are_copied_and_read_only() -> None:
    given = pp.pose((0.4, 0.0, 0.2))
    place = pp.picks.PlaceTarget(given)
    pick = pp.Pick("one", given, carried=pp.Obstacle("part", pp.Sphere(0.02)), place=place)
    picks = pp.Picks((pick,), tip=given)
    held = (pick.pose, place.pose, picks.tip, NamedFrame(given).pose, pickle.loads(pickle.dumps(pick)).pose)
    given.translation[2] = 9.0
    for each in held:
        with pytest.raises(ValueError, match="read-only"):
            each.translation[2] -= 1.0
        assert each.translation[2] == 0.2
