"""The protocol of the robots: a pure state machine with its events and messages, without clock, input or output."""
