"""Optimisers as functions of fixed size: a problem in, a step out."""
