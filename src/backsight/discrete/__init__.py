"""From continuous to discrete time: Runge-Kutta steps, exact linear steps, noise."""
