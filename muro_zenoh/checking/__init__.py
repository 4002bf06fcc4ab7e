"""Thousands of fleets in a box: trials in virtual time, and the promises that each must keep."""
