"""Time stamps: of any kind to seconds, dates as loggers write them, grids behind rounded ones."""
