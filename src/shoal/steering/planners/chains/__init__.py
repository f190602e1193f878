"""Chains of wall contacts, from which most planners make plans: queries, shortest chains, and long chains from roadmaps."""
