"""What mission files make vehicles do, judged from the files alone: time, turns, height above ground."""

from __future__ import annotations

import numpy as np
from tests.properties.flights import judged


def test_no_mission_is_longer_than_its_battery_and_no_turn_narrower_than_its_radius(tmp_path):
    """A thousand: python -m benchmarks.endurance."""
    shares, narrow, refused = [], [], 0
    for seed in range(15):
        found = judged(seed, tmp_path / str(seed))
        refused += found is None
        if found is not None:
            shares += found[0]
            narrow += found[1]
    assert refused < 3
    assert max(shares) <= 1
    assert np.mean(np.array(shares) > 0.98) > 0.2, "batteries are used"
    assert not narrow
