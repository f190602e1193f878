"""The studio: Shoal's user interface in the browser, on the user's own machine.

The studio stores everything in one folder: its files, and a database of jobs. `shoal.studio.server` serves one folder at 127.0.0.1.
`shoal.studio.guard` checks every request. Long work runs in separate processes (`shoal.studio.jobs`). Quick answers come from a
process that runs permanently (`shoal.studio.preview`).
"""
