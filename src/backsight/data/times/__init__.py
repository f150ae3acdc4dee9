"""Time stamps: of any kind to seconds, dates as loggers write them, even grids behind rounded stamps."""
