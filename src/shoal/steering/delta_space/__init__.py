"""The Δ configuration space: the differences of two particles' positions that a number of moves can reach."""
