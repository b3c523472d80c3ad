"""Runs: session files, engine, breakpoints, run files, tables, and the toolbox that makes the parts."""
