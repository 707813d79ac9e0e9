// SPDX-License-Identifier: GPL-2.0
/* The kernel's irq_sim.c as part of a module: calls that are not exported to modules are replaced by exported ones. */
#include <linux/interrupt.h>
#include <linux/irq.h>
#include <linux/irqdesc.h>

#define irq_to_desc(irq) irq_data_to_desc(irq_get_irq_data(irq))
#include "irq_sim.c"
