"""The closed loop (observe, decide, send, record) in Python and in compiled code, replays, and
episode files.
"""
