"""Questions asked of models and results; imports no estimator."""
