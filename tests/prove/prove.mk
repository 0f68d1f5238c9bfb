# No input within its stated range makes the core overflow, leave an array or divide by zero (Frama-C Eva).
prove:  ## the core under Frama-C Eva: no alarm, or each argued in tests/prove/argued.txt
	$(Q)python3 tests/prove/prove.py --build $(BUILD)

.PHONY: prove

# clang-tidy on the core, the firmware's app and the external flash; cppcheck on these, on all other firmware and on the host's C++:
# no finding.  ctuuninitvar in kf.c: imucal_kf_get_state writes the struct that it is said to read.  What is said of the host and is
# not so stands in cppcheck_host.txt with its reason.
CPPCHECK := cppcheck -q --error-exitcode=1 --suppress=missingIncludeSystem --inline-suppr
NEEDS_CPPCHECK = @command -v cppcheck >/dev/null || { echo "needs cppcheck; install it with: apt-get install cppcheck" >&2; exit 3; }
LINTED := common/*.c firmware/app/*.c firmware/flash/*.c
LINTED_FIRMWARE := firmware/sensors firmware/port/stm32f405 firmware/port/nrf51 firmware/port/riscv_virt firmware/port/arm firmware/port/posix firmware/port/sim
lint: lint-host  ## clang-tidy (.clang-tidy) and cppcheck on core and firmware, cppcheck on the host's C++: no finding
	$(NEEDS_CPPCHECK)
	@command -v clang-tidy >/dev/null || { echo "needs clang-tidy; install it with: apt-get install clang-tidy" >&2; exit 3; }
	$(Q)clang-tidy --quiet $(LINTED) -- -std=c99 -ffp-contract=off -Icommon -Ifirmware 2>/dev/null
	$(Q)$(CPPCHECK) --std=c99 --enable=warning,style,performance,portability --suppress=ctuuninitvar:common/kf.c \
	  -Icommon -Ifirmware $(LINTED)
	$(Q)$(CPPCHECK) --std=c99 --enable=warning,performance,portability -Icommon -Ifirmware $(LINTED_FIRMWARE)

lint-host:  ## cppcheck on the host's C++ (half a minute)
	$(NEEDS_CPPCHECK)
	$(Q)$(CPPCHECK) --std=c++17 --enable=warning,performance,portability --suppressions-list=tests/prove/cppcheck_host.txt \
	  -Icommon -Ihost/lib -Ihost/tools host/lib host/tools host/python/native

misra:  ## MISRA C:2012 rules that the core deviates from, with their counts (common/README.md says why)
	$(NEEDS_CPPCHECK)
	$(Q)cd common && cppcheck --std=c99 -q --addon=misra -I. *.c 2>&1 | grep -oE 'misra-c2012-[0-9.]+' | sort | uniq -c | sort -rn

.PHONY: lint lint-host misra
