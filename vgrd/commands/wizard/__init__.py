"""Teaching in a terminal: one next step, one key."""
