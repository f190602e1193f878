"""Paper W, two particles and one input: its figures 4, 8, 9 and 14 to 16, computed and drawn anew."""
