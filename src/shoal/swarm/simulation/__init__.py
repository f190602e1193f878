"""The closed loop: observe, decide, send, record; in Python, the same compiled, and the trace that both return."""
