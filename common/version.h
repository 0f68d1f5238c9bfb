/* SPDX-License-Identifier: MIT
 * The version of imucal: the one place where it is written.  The makefile, the host programs and the firmware read it here.
 *
 * MAJOR.MINOR.PATCH.  PATCH: mended, nothing to do.  MINOR: added; files, messages and command lines of before still work.
 * MAJOR: something of before no longer works, and host/CHANGELOG.md says what to do.
 * Tables and frames carry versions of their own: IMUCAL_TABLE_VERSION (table.h), IMUCAL_LINK_PROTOCOL (link.h). */
#ifndef IMUCAL_VERSION_H
#define IMUCAL_VERSION_H

#ifndef IMUCAL_VERSION /* the host's makefile hands over what it read here */
#define IMUCAL_VERSION "0.1.0"
#endif

#endif
