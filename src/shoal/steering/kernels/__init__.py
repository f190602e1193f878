"""The compiled code of the steering part: functions on plain arrays that never raise an error."""
