# The built programs through a bad line.  LINE_ROUNDS of flash, run, dump and record at each rate; SEED.
LINE_ROUNDS ?= 10

line: $(BUILD)/bin/calibrate $(BUILD)/bin/gyrosim $(BUILD)/firmware/posix/imucal  ## campaign: flash, run, dump and record through a bad line (LINE_ROUNDS, SEED)
	$(Q)BUILD=$(BUILD) $(PYTHON) tests/line/line.py --rounds $(LINE_ROUNDS) --seed $(SEED)

.PHONY: line
