# Recorded logs as a regression of `diagnose` (tests/recorded/README.md); skips loudly where ../shared/data is missing.
recorded:: host  ## campaign: what diagnose says of recorded logs against what an expert sees (exits non-zero where a row fails)
	$(Q)PYTHONPATH=tests OMP_NUM_THREADS=1 $(PYTHON) -m recorded --diagnose $(BUILD)/bin/diagnose --errormodel $(BUILD)/bin/errormodel \
	  --out $(BUILD)/recorded $(RECORDED_ARGS)

.PHONY: recorded
