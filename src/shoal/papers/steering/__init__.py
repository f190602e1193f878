"""Paper W, two particles and one input: its figures 4 to 9, 11, 12 and 14 to 16, computed and drawn anew."""
