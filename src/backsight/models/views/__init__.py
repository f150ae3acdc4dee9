"""The same model seen otherwise: scaled, in increments, fewer outputs, outputs without a sensor."""
