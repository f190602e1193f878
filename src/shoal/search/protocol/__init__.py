"""The protocol of the robots: a state machine, its events, and the messages between robots.

The state machine is a pure function, which reads no clock and does no input or output.
"""
