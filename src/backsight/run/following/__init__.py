"""Hits followed one by one: as a table, and as a task of a comparison."""

from backsight.run.following._task import FollowingTask as FollowingTask
from backsight.run.following._task import carry_out_following as carry_out_following
from backsight.run.following._task import ready_to_follow as ready_to_follow
from backsight.run.following.follow_hits import follow_hits as follow_hits
