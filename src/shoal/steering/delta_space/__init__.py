"""The Δ configuration space: the sets of position differences Δ that two particles can reach with a given number of moves."""
