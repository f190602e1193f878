"""Theory: closed forms of one dimension, schedules of scans, and bounds on the number of moves."""
