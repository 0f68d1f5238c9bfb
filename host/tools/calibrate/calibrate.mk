# `calibrate`: the device client and its tests' helpers.

$(BUILD)/tests/tty_shim.so: tests/emu/tty_shim.c $(BUILD)/flags/host_c
	@mkdir -p $(@D)
	$(Q)$(CC) -shared -fPIC -O1 $(WARNINGS) $< -o $@

system-test: $(BUILD)/tests/tty_shim.so

# `make demo LOG=file.csv` replays a recorded log.  The recursive calls see what deps has installed.
DEMO_OPTIONS = --seed $(SEED) $(if $(LOG),--log $(LOG)) $(if $(CHECK),--check-log $(CHECK)) $(if $(ORDER),--order $(ORDER)) $(if $(RATE_HZ),--rate-hz $(RATE_HZ)) $(if $(ACCEPT),--accept '$(ACCEPT)')
demo:  ## build: calibrate an emulated IMU over its serial port (LOG=file.csv: replay a recorded log)
	@$(MAKE) --no-print-directory deps
	@$(MAKE) --no-print-directory -j2 $(BUILD)/bin/gyrosim $(BUILD)/bin/calibrate $(BUILD)/firmware/mps2_an386/imucal.elf
	@$(PYTHON) host/scripts/demo.py --build $(BUILD) $(DEMO_OPTIONS)

test-long:: all
	$(Q)BUILD=$(BUILD) $(PYTHON) -m pytest -q -p no:cacheprovider tests/long/test_calibrate_cycles.py

.PHONY: demo test-long
