"""Results as a page to look at, and static figures."""

from backsight.report.page import report as report
