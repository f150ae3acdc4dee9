"""Kinds of plots of the page that have a module each: bands, profiles, maps of hits."""
