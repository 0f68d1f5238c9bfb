# No input within its stated range makes the core overflow, leave an array or divide by zero (Frama-C Eva).
prove:  ## the core under Frama-C Eva: no alarm, or each argued in tests/prove/argued.txt
	$(Q)python3 tests/prove/prove.py --build $(BUILD)

.PHONY: prove
