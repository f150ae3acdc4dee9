"""Recordings that are larger than memory, read part by part."""

from backsight.data.parts.parts import RecordingParts as RecordingParts
from backsight.data.parts.parts import read_parts as read_parts
