"""Pulses at any place and moment: where a fit begins, and the fit."""
