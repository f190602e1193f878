"""The studio: Shoal's user interface in the browser, on the user's own machine.

The studio stores all its data in one folder: the user's files, and a database of jobs.
`shoal.studio.server` serves one folder at the address 127.0.0.1. `shoal.studio.guard` checks every
request of a browser. Long jobs run in processes of their own (`shoal.studio.jobs`). Quick answers
come from permanent processes (`shoal.studio.preview`).
"""
