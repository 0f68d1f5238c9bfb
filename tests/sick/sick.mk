# `make sick`: faults are injected into logs, files and command lines; none may end in a table with status 0, and healthy
# runs must pass.  HEALTHY=n: how many of these; SAVE=1: as the README states them.  Its short form is tests/system/test_sick.py.
HEALTHY ?= 1000
sick: host firmware  ## campaign: inject faults: found by what, with which message and status, flashed or not (HEALTHY=1000 healthy runs beside)
	$(Q)PYTHONPATH=tests $(PYTHON) -m sick --programs $(BUILD)/bin --out $(BUILD)/sick --healthy $(HEALTHY) $(if $(SAVE),--save tests/saved/sick.md)

.PHONY: sick
