"""Tests with libraries for reinforcement learning run by ``make test-clients`` only."""

from __future__ import annotations

from importlib.util import find_spec

collect_ignore_glob = [] if find_spec("stable_baselines3") else ["test_*.py"]
