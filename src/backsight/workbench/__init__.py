"""A page in the browser, for this computer only: from a recording to a report without Python.

It asks what a problem file says, writes that file, and runs it as ``backsight run`` does.
"""

from backsight.workbench.serving import open_workbench as open_workbench
