"""What a recording tells of parameters: bands, profiles, and estimates that make no sense."""
