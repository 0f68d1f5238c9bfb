# Lines and branches that the unit tests of the core and of the firmware's app run.
coverage:  ## test: every line of common/ and firmware/app/ run by their unit tests and every branch taken, or argued (gcov)
	$(Q)python3 tests/coverage/coverage.py --build $(BUILD)

.PHONY: coverage
