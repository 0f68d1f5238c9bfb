# make install / uninstall / deb / dist.  Only `imucal` goes into bin: names as general as dp live in libexec/imucal.
PREFIX ?= /usr/local
DESTDIR ?=
ROOT_DIR = $(DESTDIR)$(PREFIX)
CORE_ARCHIVE := $(BUILD)/lib/libimucal_core.a
SHELL_FILES := $(BUILD)/shell/done
INSTALL_MANIFEST = $(ROOT_DIR)/lib/imucal/manifest

$(CORE_ARCHIVE): $(CORE_OBJECTS)
	@mkdir -p $(@D)
	$(Q)rm -f $@ && $(AR) rcs $@ $^

# The package's own part needs the programs' help; the Python subcommands answer with the venv's interpreter.
$(SHELL_FILES): host/scripts/shell_files.py $(HOST_PROGRAMS)
	$(Q)$(PYTHON) host/scripts/shell_files.py $(BUILD)/bin/imucal -o $(BUILD)/shell && touch $@

install: host $(CORE_ARCHIVE) $(PY_CORE) $(SHELL_FILES)  ## package: install under PREFIX (default /usr/local; DESTDIR for packages)
	$(Q)PREFIX='$(PREFIX)' DESTDIR='$(DESTDIR)' BUILD='$(BUILD)' VERSION='$(VERSION)' host/packaging/install.sh

uninstall:  ## package: remove what install put under PREFIX
	$(Q)[ -f '$(INSTALL_MANIFEST)' ] || { echo "imucal: nothing installed by make under $(ROOT_DIR) (no lib/imucal/manifest)" >&2; exit 1; }
	$(Q)sed 's|^|$(ROOT_DIR)/|' '$(INSTALL_MANIFEST)' | xargs -d '\n' rm -f
	$(Q)rm -f '$(INSTALL_MANIFEST)'; find '$(ROOT_DIR)/lib/imucal' -name __pycache__ -prune -exec rm -rf {} +
	$(Q)for d in lib/imucal libexec/imucal include/imucal lib/cmake/imucal; do find '$(ROOT_DIR)'/$$d -depth -type d -empty -delete 2>/dev/null || :; done
	@echo "imucal: removed from $(ROOT_DIR)"

deb:  ## package: a Debian package in build/
	$(Q)rm -rf $(BUILD)/deb && mkdir -p $(BUILD)/deb/root
	$(Q)$(MAKE) --no-print-directory install PREFIX=/usr DESTDIR=$(abspath $(BUILD))/deb/root
	$(Q)BUILD='$(BUILD)' VERSION='$(VERSION)' host/packaging/deb.sh

deb-check: deb  ## package: install the Debian package in a clean root and run it there (mmdebstrap, as root)
	$(Q)BUILD='$(BUILD)' VERSION='$(VERSION)' host/packaging/deb_check.sh

dist:  ## package: archives of common/ for Arduino, PlatformIO, Zephyr, ESP-IDF, CMake, each checked
	$(Q)$(PYTHON) host/packaging/dist.py --version $(VERSION) -o $(BUILD)/dist --check

unit-programs system-test: $(CORE_ARCHIVE) $(SHELL_FILES)

.PHONY: install uninstall deb deb-check dist
