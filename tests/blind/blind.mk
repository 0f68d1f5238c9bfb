# Blind check of `diagnose` (tests/blind/README.md).  Default: fresh cases from operating-system entropy.
#   make blind                          about 400 cases with an effect, 300 without
#   make blind CASES=100 GAP_FREE=60    fewer
#   make blind BLIND_SEED=123           repeat a draw
CASES ?= 400
GAP_FREE ?= 300
BLIND_SEED ?=
BLIND_ARGS ?=

blind:: host  ## score diagnose on fresh cases whose labels it cannot see (CASES= GAP_FREE= BLIND_SEED=)
	$(Q)PYTHONPATH=tests OMP_NUM_THREADS=1 nice -n 5 $(PYTHON) -m blind --diagnose $(BUILD)/bin/diagnose --out $(BUILD)/blind \
	  --cases $(CASES) --gap-free $(GAP_FREE) $(if $(BLIND_SEED),--seed $(BLIND_SEED)) $(BLIND_ARGS)

.PHONY: blind
