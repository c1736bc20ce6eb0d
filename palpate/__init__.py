"""Palpate: drivers, simulators and procedures for a bench that tests piezoelectric tactile sensors.

The folders `drivers`, `instrument`, `simulators` and `procedures` stand at the top of the repository. Symbolic links in
this package give them import names of their own (`palpate.drivers`), which do not collide with folders of a laboratory.
"""
