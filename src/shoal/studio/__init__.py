"""The studio: Shoal in the browser, on one's own machine.

A folder's files are the only state, and a store of jobs in it. `shoal.studio.server` serves one folder at 127.0.0.1;
`shoal.studio.guard` stands before everything that it answers; long work runs in processes of its own (`shoal.studio.jobs`), quick
answers come from one that stays (`shoal.studio.preview`).
"""
