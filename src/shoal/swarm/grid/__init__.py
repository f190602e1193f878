"""The grid world: boards, commands, moves, beliefs, tasks, placements and scans."""
