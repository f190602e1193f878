"""The closed loop (observe, decide, send, record) in Python and compiled, replays, and the file of an episode."""
