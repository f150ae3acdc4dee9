"""Programs whose constants follow settings."""

from backsight.engine.program.following._following import Beginning as Beginning
from backsight.engine.program.following._following import following as following
from backsight.engine.program.following._following import starting as starting
