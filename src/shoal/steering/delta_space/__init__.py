"""The Δ configuration space: which differences of two particles two moves, and more, can make."""
