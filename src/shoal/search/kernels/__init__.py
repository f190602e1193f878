"""The compiled code of the search part: functions on plain arrays that never raise an error."""
