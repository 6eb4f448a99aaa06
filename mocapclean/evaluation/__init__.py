"""Numbers that judge a repair."""
