# No input within its stated range makes the core overflow, leave an array or divide by zero (Frama-C Eva).
prove:  ## the core under Frama-C Eva: no alarm, or each argued in tests/prove/argued.txt
	$(Q)python3 tests/prove/prove.py --build $(BUILD)

.PHONY: prove

# cppcheck on the core and the app: no finding.  ctuuninitvar in kf.c: imucal_kf_get_state writes the struct that it is said to read.
CPPCHECK := cppcheck --std=c99 -q
NEEDS_CPPCHECK = @command -v cppcheck >/dev/null || { echo "needs cppcheck; install it with: apt-get install cppcheck" >&2; exit 3; }
LINTED := common/*.c firmware/app/*.c
lint:  ## clang-tidy (.clang-tidy) and cppcheck on the core and the firmware's app: no finding
	$(NEEDS_CPPCHECK)
	@command -v clang-tidy >/dev/null || { echo "needs clang-tidy; install it with: apt-get install clang-tidy" >&2; exit 3; }
	$(Q)clang-tidy --quiet $(LINTED) -- -std=c99 -ffp-contract=off -Icommon -Ifirmware 2>/dev/null
	$(Q)$(CPPCHECK) --enable=warning,style,performance,portability --suppress=missingIncludeSystem --suppress=ctuuninitvar:common/kf.c \
	  --error-exitcode=1 -Icommon -Ifirmware $(LINTED)

misra:  ## MISRA C:2012 rules that the core deviates from, with their counts (common/README.md says why)
	$(NEEDS_CPPCHECK)
	$(Q)cd common && $(CPPCHECK) --addon=misra -I. *.c 2>&1 | grep -oE 'misra-c2012-[0-9.]+' | sort | uniq -c | sort -rn

.PHONY: lint misra
