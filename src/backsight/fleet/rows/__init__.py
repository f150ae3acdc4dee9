"""What is kept of a fleet: rows, in a store, as a table."""

from backsight.fleet.rows.landed import Landed as Landed
from backsight.fleet.rows.numbers import Told as Told
from backsight.fleet.rows.numbers import failed_row as failed_row
from backsight.fleet.rows.store import RESULTS as RESULTS
from backsight.fleet.rows.store import FleetStore as FleetStore
from backsight.fleet.rows.store import Known as Known
from backsight.fleet.rows.store import opened_fleet_store as opened_fleet_store
from backsight.fleet.rows.store import reading_store as reading_store
from backsight.fleet.rows.store import stamp_text as stamp_text
from backsight.fleet.rows.table import BECAUSE as BECAUSE
from backsight.fleet.rows.table import OUTLYING as OUTLYING
from backsight.fleet.rows.table import judged as judged
from backsight.fleet.rows.table import read_rows as read_rows
from backsight.fleet.rows.table import write_table as write_table
