"""Fleets: many recordings times many settings, on all cores or on a cluster."""

from backsight.fleet.fleet import Fleet as Fleet
from backsight.fleet.fleet import load_fleet as load_fleet
from backsight.fleet.rows import read_rows as read_rows
from backsight.fleet.rows import write_table as write_table
from backsight.fleet.running import run_fleet as run_fleet
from backsight.fleet.single import problem_of_item as problem_of_item
