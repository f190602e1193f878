"""Theory of the papers: exact formulas in one dimension, scan schedules, and bounds on the number of moves."""
