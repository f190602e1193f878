"""Chains of contacts, with which most planners work: queries, shortest chains, and long chains from roadmaps."""
