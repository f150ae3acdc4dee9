"""Where results are kept while they come."""

from backsight.live.store.journal import Journal as Journal
from backsight.live.store.journal import journaled as journaled
from backsight.live.store.keeping import Keeper as Keeper
from backsight.live.store.keeping import checkpoint_bytes as checkpoint_bytes
from backsight.live.store.keeping import column_units as column_units
from backsight.live.store.keeping import columns_of as columns_of
from backsight.live.store.keeping import joined_rows as joined_rows
from backsight.live.store.writing import LiveStore as LiveStore
from backsight.live.store.writing import arrow as arrow
from backsight.live.store.writing import opened_live_store as opened_live_store
