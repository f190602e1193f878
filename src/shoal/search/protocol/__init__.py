"""The protocol of the robots: a pure state machine with its events and messages.

The state machine uses no clock, no input and no output.
"""
