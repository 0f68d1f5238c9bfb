# Time and memory of diagnose, and how they grow with runs and seconds (calibration of the nulls apart).
BENCH_DIAGNOSE = $(PYTHON) host/scripts/bench_diagnose.py --bin $(BUILD)/bin

bench:: $(BUILD)/bin/diagnose $(BUILD)/bin/gyrosim
	$(Q)$(BENCH_DIAGNOSE)

.PHONY: bench
