"""What a file holds: its columns, its clock, and what looks wrong in them."""

from backsight.data.listing._channel import clipped_ends as clipped_ends
from backsight.data.listing.found import FileColumn as FileColumn
from backsight.data.listing.found import FileColumns as FileColumns
from backsight.data.listing.listing import list_columns as list_columns
