"""From the spectral density of continuous noise to its covariance over a sampling period."""
