"""Chains of contacts, the common basis of most planners: queries, shortest chains, and long chains from roadmaps."""
