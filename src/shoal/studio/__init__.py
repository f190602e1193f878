"""The studio: Shoal's user interface in the browser, on the user's own machine.

The only state is the files of a folder and a store of jobs in it. `shoal.studio.server` serves one folder at 127.0.0.1.
`shoal.studio.guard` checks every request. Long work runs in separate processes (`shoal.studio.jobs`). Quick answers come from a
permanent process (`shoal.studio.preview`).
"""
