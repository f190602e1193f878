"""The protocol of the robots and its simulation, compiled: many worlds, each with many robots.

The modules mirror those of the plain state machine, which live robots run: `costs` the costs of
`shoal.search.allocation.costs`, `knowledge` and `deciding` those of `shoal.search.protocol`, and
`events` the world of `shoal.search.simulation.world`. `tests/reference/test_search_engine.py` lets
both act side by side, event by event and message by message.
"""
