"""The assessor: sealed answers and collected findings in, a score out. Imports neither the world nor the tool."""
