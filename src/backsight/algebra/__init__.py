"""Formulas on CasADi expressions."""
