"""Chains of contacts, which most planners plan with: the query, the shortest chain, and chains of many cycles over roadmaps."""
