// SPDX-License-Identifier: GPL-2.0
/*
 * A GPIO chip whose lines are wires with pull-ups, and a program at their far end.
 *
 * A wire is low while the consumer of its GPIO line drives it low, or the far end pulls it: what a
 * bus of open-drain lines is, and gpio-sim is not, because there an output reads back what its
 * consumer wrote, and a line that is released keeps the level that was driven.
 *
 * The far end is whoever has /dev/lab_wires open, one program at a time:
 *
 *   read    a byte for each change of the wires since it was opened: their levels after it, a bit
 *           for each; non-blocking reads and poll() are supported.  EOVERFLOW: some were lost.
 *   write   a byte: the wires that it pulls low, from now on.
 *
 * With stretch=MASK, a wire of MASK that its consumer pulls low is also pulled by the far end, at
 * once, until its next write: a chip that stretches the clock for as long as it needs.  So the far
 * end may be slow without being late.
 */
#include <linux/gpio/driver.h>
#include <linux/kfifo.h>
#include <linux/miscdevice.h>
#include <linux/module.h>
#include <linux/platform_device.h>
#include <linux/poll.h>
#include <linux/spinlock.h>
#include <linux/uaccess.h>
#include <linux/wait.h>

#define DRIVER_NAME	"lab_wires"
#define WIRES_MAX	8

static unsigned int wires = 2;
module_param(wires, uint, 0444);
MODULE_PARM_DESC(wires, "number of wires, up to 8 [2]");

static unsigned int stretch;
module_param(stretch, uint, 0444);
MODULE_PARM_DESC(stretch, "wires that the far end keeps low after each fall, until its next write [none]");

static DEFINE_SPINLOCK(lock);
/* Guarded by lock. */
static u8 outputs;	/* the consumer drives the wire */
static u8 high;		/* to this level */
static u8 pulled;	/* the far end pulls it low */
static u8 before;	/* levels after the last change */
static bool open;
static bool lost;
static DEFINE_KFIFO(changes, u8, 1024);
static DECLARE_WAIT_QUEUE_HEAD(changed);

static struct platform_device *device;

/* Called with lock held. */
static u8 levels(void)
{
	return ~(pulled | (outputs & ~high)) & GENMASK(wires - 1, 0);
}

/* Called with lock held, after a change of what the wires depend on. */
static void look(void)
{
	u8 now = levels();

	if (open)
		pulled |= before & ~now & stretch;
	if (now == before)
		return;
	before = now;
	if (!open)
		return;
	if (!kfifo_put(&changes, now))
		lost = true;
	wake_up_interruptible(&changed);
}

/* The near end: GPIO lines. */

static int wires_get_direction(struct gpio_chip *chip, unsigned int line)
{
	unsigned long flags;
	bool driven;

	spin_lock_irqsave(&lock, flags);
	driven = outputs & BIT(line);
	spin_unlock_irqrestore(&lock, flags);
	return driven ? GPIO_LINE_DIRECTION_OUT : GPIO_LINE_DIRECTION_IN;
}

static int wires_direction_input(struct gpio_chip *chip, unsigned int line)
{
	unsigned long flags;

	spin_lock_irqsave(&lock, flags);
	outputs &= ~BIT(line);
	look();
	spin_unlock_irqrestore(&lock, flags);
	return 0;
}

static void drive(unsigned int line, int value)
{
	if (value)
		high |= BIT(line);
	else
		high &= ~BIT(line);
}

static int wires_direction_output(struct gpio_chip *chip, unsigned int line, int value)
{
	unsigned long flags;

	spin_lock_irqsave(&lock, flags);
	drive(line, value);
	outputs |= BIT(line);
	look();
	spin_unlock_irqrestore(&lock, flags);
	return 0;
}

static void wires_set(struct gpio_chip *chip, unsigned int line, int value)
{
	unsigned long flags;

	spin_lock_irqsave(&lock, flags);
	drive(line, value);
	look();
	spin_unlock_irqrestore(&lock, flags);
}

static int wires_get(struct gpio_chip *chip, unsigned int line)
{
	unsigned long flags;
	bool level;

	spin_lock_irqsave(&lock, flags);
	level = levels() & BIT(line);
	spin_unlock_irqrestore(&lock, flags);
	return level;
}

/*
 * There is no set_config: like most chips, it leaves open drain to gpiolib, which makes a line that
 * is released an input.
 */
static struct gpio_chip wires_chip = {
	.label			= DRIVER_NAME,
	.owner			= THIS_MODULE,
	.base			= -1,
	.get_direction		= wires_get_direction,
	.direction_input	= wires_direction_input,
	.direction_output	= wires_direction_output,
	.set			= wires_set,
	.get			= wires_get,
};

/* The far end. */

static int far_open(struct inode *inode, struct file *file)
{
	unsigned long flags;
	int error = 0;

	spin_lock_irqsave(&lock, flags);
	if (open) {
		error = -EBUSY;
	} else {
		open = true;
		lost = false;
		kfifo_reset(&changes);
		before = levels();
	}
	spin_unlock_irqrestore(&lock, flags);
	return error;
}

static int far_release(struct inode *inode, struct file *file)
{
	unsigned long flags;

	spin_lock_irqsave(&lock, flags);
	open = false;
	pulled = 0;
	look();
	spin_unlock_irqrestore(&lock, flags);
	return 0;
}

static ssize_t far_read(struct file *file, char __user *to, size_t size, loff_t *offset)
{
	u8 bytes[64];
	unsigned long flags;
	unsigned int count;
	bool gap;

	if (!size)
		return 0;
	for (;;) {
		spin_lock_irqsave(&lock, flags);
		gap = lost;
		lost = false;
		count = gap ? 0 : kfifo_out(&changes, bytes, min(size, sizeof(bytes)));
		spin_unlock_irqrestore(&lock, flags);
		if (gap)
			return -EOVERFLOW;
		if (count)
			return copy_to_user(to, bytes, count) ? -EFAULT : count;
		if (file->f_flags & O_NONBLOCK)
			return -EAGAIN;
		if (wait_event_interruptible(changed, !kfifo_is_empty(&changes) || READ_ONCE(lost)))
			return -ERESTARTSYS;
	}
}

static ssize_t far_write(struct file *file, const char __user *from, size_t size, loff_t *offset)
{
	unsigned long flags;
	u8 mask;

	if (size != 1)
		return -EINVAL;
	if (get_user(mask, (const u8 __user *)from))
		return -EFAULT;
	spin_lock_irqsave(&lock, flags);
	pulled = mask & GENMASK(wires - 1, 0);
	look();
	spin_unlock_irqrestore(&lock, flags);
	return 1;
}

static __poll_t far_poll(struct file *file, poll_table *table)
{
	poll_wait(file, &changed, table);
	return EPOLLOUT | (kfifo_is_empty(&changes) && !READ_ONCE(lost) ? 0 : EPOLLIN);
}

static const struct file_operations far_operations = {
	.owner		= THIS_MODULE,
	.open		= far_open,
	.release	= far_release,
	.read		= far_read,
	.write		= far_write,
	.poll		= far_poll,
	.llseek		= no_llseek,
};

static struct miscdevice far_end = {
	.minor	= MISC_DYNAMIC_MINOR,
	.name	= DRIVER_NAME,
	.fops	= &far_operations,
	.mode	= 0600,
};

static int __init wires_init(void)
{
	int error;

	if (!wires || wires > WIRES_MAX)
		return -EINVAL;
	before = levels();
	device = platform_device_register_simple(DRIVER_NAME, PLATFORM_DEVID_NONE, NULL, 0);
	if (IS_ERR(device))
		return PTR_ERR(device);
	wires_chip.parent = &device->dev;
	wires_chip.ngpio = wires;
	error = gpiochip_add_data(&wires_chip, NULL);
	if (error)
		goto unregister;
	error = misc_register(&far_end);
	if (error)
		goto remove;
	return 0;

remove:
	gpiochip_remove(&wires_chip);
unregister:
	platform_device_unregister(device);
	return error;
}

static void __exit wires_exit(void)
{
	misc_deregister(&far_end);
	gpiochip_remove(&wires_chip);
	platform_device_unregister(device);
}

module_init(wires_init);
module_exit(wires_exit);

MODULE_LICENSE("GPL");
MODULE_DESCRIPTION("GPIO lines as wires with pull-ups, and a program at their far end");
