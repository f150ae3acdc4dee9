"""Files that hold more than text, one small reader each."""
