"""Policies that simulate plans in the predicted world before they send a command."""
