"""What goes into a shield and comes out of it: checked rows, facts, and the sentences of its errors."""
