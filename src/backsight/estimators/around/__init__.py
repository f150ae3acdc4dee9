"""What surrounds every method, written once: noise as states, angles, outliers, virtual outputs."""
