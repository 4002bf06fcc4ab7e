"""Whole fleets in one process, in virtual time and with faults: the real agents, bases and base station."""
