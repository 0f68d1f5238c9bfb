# The host library and its unit tests on other machines and with another compiler: `make portable`.
# Foreign libraries are Debian's, unpacked under build/portable/<architecture> (tests/portable/fetch_libraries); foreign
# programs run under qemu-user.  Compilers come from the packages named in tests/portable/packages.
# Not to be had: Debian keeps no i386 or arm64 shortcut for the header-only parts, nor needs one: they are the machine's.

PORTABLE := $(BUILD)/portable
# T=<filter> as in `make test`: the short form for CI is T=noise.
PORTABLE_TESTS = $(patsubst tests/%.cpp,%,$(wildcard tests/host/test_*.cpp))
PORTABLE_SELECTED = $(call some_selected,$(PORTABLE_TESTS))

# $1 Debian architecture, $2 GNU triplet of the compiler, $3 its folder of libraries
root_of = $(CURDIR)/$(PORTABLE)/$1/root
foreign_make = $(MAKE) --no-print-directory BUILD=$(PORTABLE)/$1/build PCH= CC=$2-gcc CXX=$2-g++ AR=$2-ar CCACHE="$(CCACHE)" \
    CFLAGS="$4" CXXFLAGS="$4" \
    LDFLAGS="-L$(call root_of,$1)/usr/lib/$3 -Wl,-rpath-link,$(call root_of,$1)/usr/lib/$3:$(call root_of,$1)/lib/$3 -Wl,--allow-shlib-undefined"

$(PORTABLE)/%/done:
	$(Q)tests/portable/fetch_libraries $* $(@D)

portable:: portable-clang portable-arm64 portable-i386  ## test: unit tests of the host with clang, as aarch64 and as 32-bit x86 (T=<filter> for some)

portable-clang:
	$(Q)$(MAKE) --no-print-directory BUILD=$(PORTABLE)/clang PCH= CC=clang CXX=clang++ $(addprefix $(PORTABLE)/clang/tests/,$(PORTABLE_SELECTED))
	$(Q)BUILD=$(PORTABLE)/clang tests/run_unit $(addprefix $(PORTABLE)/clang/tests/,$(PORTABLE_SELECTED))

portable-arm64: $(PORTABLE)/arm64/done
	$(Q)$(call foreign_make,arm64,aarch64-linux-gnu,aarch64-linux-gnu,) $(addprefix $(PORTABLE)/arm64/build/tests/,$(PORTABLE_SELECTED))
	$(Q)RUN="qemu-aarch64 -L $(call root_of,arm64)" tests/run_unit $(addprefix $(PORTABLE)/arm64/build/tests/,$(PORTABLE_SELECTED))

# x87 registers hold more digits than a double: SSE2 keeps the bits of every other machine.  Times of 64 bits: tables carry
# dates up to 2106.
# A processor of 64 bits runs them itself, ten times as fast as qemu, if its kernel lets it.
run_i386 = loader=$1/lib/i386-linux-gnu/ld-linux.so.2; if $$loader --version >/dev/null 2>&1; \
    then echo "$$loader --library-path $1/usr/lib/i386-linux-gnu:$1/lib/i386-linux-gnu"; else echo "qemu-i386 -L $1"; fi
portable-i386: $(PORTABLE)/i386/done
	$(Q)$(call foreign_make,i386,i686-linux-gnu,i386-linux-gnu,-msse2 -mfpmath=sse -D_FILE_OFFSET_BITS=64 -D_TIME_BITS=64) $(addprefix $(PORTABLE)/i386/build/tests/,$(PORTABLE_SELECTED))
	$(Q)RUN="$$($(call run_i386,$(call root_of,i386)))" tests/run_unit $(addprefix $(PORTABLE)/i386/build/tests/,$(PORTABLE_SELECTED))

.PHONY: portable portable-clang portable-arm64 portable-i386
