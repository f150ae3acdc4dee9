"""Files that hold more than text, one small reader each."""

from backsight.data.formats._hdf5 import check_dataset as check_dataset
from backsight.data.formats._hdf5 import check_links as check_links
from backsight.data.formats._hdf5 import datasets as datasets
from backsight.data.formats.libraries import library as library
