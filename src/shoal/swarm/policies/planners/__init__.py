"""Planning policies: they simulate plans in a predicted world before they send a command."""
