"""Files of recorders, simulators and robots, one small reader each."""

from backsight.data.formats.recorders._hawc2 import list_hawc2 as list_hawc2
from backsight.data.formats.recorders._hawc2 import read_hawc2 as read_hawc2
from backsight.data.formats.recorders._lvm import list_lvm as list_lvm
from backsight.data.formats.recorders._lvm import read_lvm as read_lvm
from backsight.data.formats.recorders._mcap import list_mcap as list_mcap
from backsight.data.formats.recorders._mcap import read_mcap as read_mcap
from backsight.data.formats.recorders._mdf import list_mdf as list_mdf
from backsight.data.formats.recorders._mdf import read_mdf as read_mdf
from backsight.data.formats.recorders._openfast import list_outb as list_outb
from backsight.data.formats.recorders._openfast import read_outb as read_outb
from backsight.data.formats.recorders._ros import list_bag as list_bag
from backsight.data.formats.recorders._ros import read_bag as read_bag
from backsight.data.formats.recorders._tdms import list_tdms as list_tdms
from backsight.data.formats.recorders._tdms import read_tdms as read_tdms
from backsight.data.formats.recorders._uff import list_uff as list_uff
from backsight.data.formats.recorders._uff import read_uff as read_uff
from backsight.data.formats.recorders._wav import list_wav as list_wav
from backsight.data.formats.recorders._wav import read_wav as read_wav
