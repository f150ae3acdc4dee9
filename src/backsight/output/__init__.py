"""Files and folders that are there whole or not at all, and that replace nothing of others."""

from backsight.output._disk import make_folder as make_folder
from backsight.output._disk import put_in_place as put_in_place
from backsight.output._disk import writing as writing
from backsight.output._locking import holding as holding
from backsight.output._moving import folder_entries as folder_entries
from backsight.output._moving import tidy as tidy
from backsight.output._netcdf import netcdf_file as netcdf_file
from backsight.output._whole import MARKER as MARKER
from backsight.output._whole import whole as whole
from backsight.output._whole import write_whole as write_whole
