# The documentation site: build/docs/site.
docs: host $(PY_CORE)  ## package: the documentation site in build/docs/site (MkDocs in a venv of its own), links checked
	$(Q)mkdir -p $(BUILD)/docs
	$(Q)cmp -s host/scripts/requirements-docs.txt $(BUILD)/docs/venv/installed || { python3 -m venv $(BUILD)/docs/venv && \
	  $(BUILD)/docs/venv/bin/pip install --quiet --disable-pip-version-check -r host/scripts/requirements-docs.txt && cp host/scripts/requirements-docs.txt $(BUILD)/docs/venv/installed; }
	$(Q)IMUCAL_BIN=$(abspath $(BUILD))/bin $(PYTHON) host/scripts/docs.py -o $(BUILD)/docs
	$(Q)$(BUILD)/docs/venv/bin/mkdocs --quiet build --strict --config-file $(BUILD)/docs/mkdocs.yml --site-dir site

.PHONY: docs
