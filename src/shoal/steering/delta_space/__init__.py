"""The Δ configuration space: the differences of two particles' positions that a given number of moves can reach."""
