"""Control: from what is known of the machine to what is asked of it."""
